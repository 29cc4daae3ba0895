"""Numbers only: small-matrix conditioning, point sequences, the sweep and its compilation.

Nothing here knows of units, mechanisms, configurations or files of results.
"""

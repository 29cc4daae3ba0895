"""The mechanisms, one file each; forward kinematics in a file beside it."""

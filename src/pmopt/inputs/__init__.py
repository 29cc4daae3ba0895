"""What users type and their programs write: quantities with units, tables, text of files."""

"""What people type and what their programs write: quantities with units, tables, text of files."""

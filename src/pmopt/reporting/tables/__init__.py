"""Results as tables: text, CSV and JSON."""

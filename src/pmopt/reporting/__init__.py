"""From results to tables, pictures and run folders."""

"""Drawing of computed results."""

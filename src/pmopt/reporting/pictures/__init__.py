"""Drawing of what is already computed."""

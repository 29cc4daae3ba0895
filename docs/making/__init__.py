"""What makes the figures, tables and pictures of the documents, and holds the documents to them."""

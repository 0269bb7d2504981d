"""Pages of docs that are written from committed results."""

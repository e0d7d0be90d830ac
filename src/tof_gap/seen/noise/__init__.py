"""Effects that noise shows."""

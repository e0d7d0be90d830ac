"""Effects that missing, wrapped and mixed pixels show."""

"""Light that is not the camera's own."""

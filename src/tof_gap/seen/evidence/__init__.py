"""What a view gives for the fit: residuals, their noise, edges, patterns, and what the camera did to its image."""

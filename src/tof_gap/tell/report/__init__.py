"""The report: files, page, pictures, words."""

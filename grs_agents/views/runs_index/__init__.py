"""Index of the runs below a folder, as a page."""

"""What the two sides of the sandbox say to each other: orders, settings, reports, tracebacks."""

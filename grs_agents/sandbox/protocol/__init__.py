"""Messages between the two sides of the sandbox: orders, settings, reports, tracebacks."""

"""Developer scripts for a checkout."""

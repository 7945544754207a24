"""What makes a result trustworthy: checks on task instances, measured by trusted code."""

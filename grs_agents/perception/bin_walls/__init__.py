"""Where the photo shows the walls of a bin that the things lie in."""

"""A task instance for other programs: a folder with an MJCF file that opens in plain MuJoCo."""

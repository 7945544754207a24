"""What generated programs import: CLIPort's Task, Environment, utilities and PyBullet's calls."""

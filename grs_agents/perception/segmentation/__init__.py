"""Which pixels belong to which object."""

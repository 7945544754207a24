"""Import of third-party 3D models: read with care, checked, repaired, weighed and written in a common form."""

"""Model files read with care: URDF and MJCF."""

"""Common parts of the views: events as text, steps, motion, scene objects."""

"""What several views share: events as text, steps, motion, the objects of a run."""

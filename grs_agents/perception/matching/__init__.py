"""Which asset stands for which object of a photo."""

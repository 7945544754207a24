"""Readers of a scene from a folder, a data set, an archive or a photo; faults are refused by InputError."""

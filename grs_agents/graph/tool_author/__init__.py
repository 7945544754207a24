"""Read a scene from a folder, a data set, an archive or a photo; what is wrong with it is refused by InputError."""

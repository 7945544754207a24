"""The page on which a person corrects a scene."""

from .bin_walls import find_bin_walls as find_bin_walls
from .seen_walls import SeenWalls as SeenWalls

from .base_scene import BaseScene as BaseScene
from .base_scene import measure_base_scene as measure_base_scene
from .parts import Part as Part
from .types import Variation as Variation
from .vary import vary_instance as vary_instance

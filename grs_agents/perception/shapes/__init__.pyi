from .types import ObjectShape as ObjectShape
from .types import ObjectView as ObjectView
from .types import ShapeMethod as ShapeMethod
from .types import TexturedMesh as TexturedMesh

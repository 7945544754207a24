"""What the index of assets costs with as many as Objaverse holds, and how many of the true nearest it finds."""

import argparse
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from grs_agents.correspondence.embedding import Vectors, embed
from grs_agents.correspondence.index import AssetIndex
from grs_agents.correspondence.tone import histograms
from grs_agents.errors import InputError
from grs_agents.files import write_json
from grs_agents.measure.process import run_alone
from grs_agents.run.experiment import positive

_KINDS = ("can", "box", "bottle", "jar", "carton", "mug", "bowl", "plate", "toy", "tool", "book", "shoe", "lamp", "cup",
          "basket", "knife", "spoon", "pan", "brush", "ball", "car", "figure", "vase", "clock", "chair")  # fmt: skip
_COLORS = ("red", "green", "blue", "yellow", "white", "black", "brown", "orange", "pink", "purple", "gray", "cyan")
_LOOKS = ("wooden", "plastic", "metal", "glass", "striped", "dotted", "plain", "worn", "shiny", "small", "large", "old")
_MEBIBYTE = 1024 * 1024 if sys.platform == "darwin" else 1024

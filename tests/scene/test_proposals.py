"""Masks that a model proposes, stood in for by masks made from the truth: parts, groups, tables, noise."""

from collections.abc import Iterable

import cv2
import numpy as np
import pytest
from conftest import THINGS, Array, Rendered, Thing, render
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.scene import Proposal, candidates_of, find_table, segment_proposed
from grs_agents.scene.proposals import ALIKE, Mask, distinct

from .oracle import Oracle as Oracle
from .oracle import predict_dragged_rope as predict_dragged_rope
from .push_oracle import Pieces as Pieces
from .push_oracle import PushOracle as PushOracle
from .push_oracle import Strokes as Strokes
from .push_oracle import find_clear_stroke_starts as find_clear_stroke_starts
from .push_oracle import predict_piece_positions as predict_piece_positions

from .oracle import Oracle as Oracle
from .oracle import dragged_rope as dragged_rope
from .push_oracle import Pieces as Pieces
from .push_oracle import PushOracle as PushOracle
from .push_oracle import Strokes as Strokes
from .push_oracle import predict_places as predict_places
from .push_oracle import starts_clear_of_pieces as starts_clear_of_pieces

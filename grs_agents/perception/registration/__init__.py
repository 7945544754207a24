"""Registration of matched assets: pose hypotheses, cost, refinement, and unexplained segments."""

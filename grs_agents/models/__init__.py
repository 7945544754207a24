"""Chat models: one seam for intelligence, from the embedded ``offline`` model to any provider."""

"""Chat models, from the embedded ``offline`` model to any provider."""

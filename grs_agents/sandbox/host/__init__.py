"""The outside of the sandbox: it starts workers, hands out work and reads their output."""

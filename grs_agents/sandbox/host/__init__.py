"""What runs outside the sandbox: it starts workers, hands out work and reads what comes back."""

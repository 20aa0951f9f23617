"""Play saved models and plans, and write their performances."""

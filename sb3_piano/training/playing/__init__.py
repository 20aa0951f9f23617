"""Players of saved models and plans, and what there is to see and hear of them."""

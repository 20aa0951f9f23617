"""What may be searched: parameters, the settings they are for, and spaces of them."""

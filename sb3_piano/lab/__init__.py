"""Tools that made the shipped network, its results and its web page; other rooms do not use it."""

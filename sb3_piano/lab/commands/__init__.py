"""Commands of the lab, apart from what they call, so that their help is fast."""

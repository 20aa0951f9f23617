"""Exported runs: for others to load without pickles, on disk and on the Hugging Face Hub."""

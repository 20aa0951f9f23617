"""Exported runs without pickles, on disk and on the Hugging Face Hub."""

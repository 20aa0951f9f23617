"""What the page in the browser needs of this package, as files."""

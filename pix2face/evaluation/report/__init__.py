"""Reports as text, JSON and HTML, and comparisons of two of them."""

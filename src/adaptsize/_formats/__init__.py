"""File formats for ``adaptsize.io``: one module per family."""

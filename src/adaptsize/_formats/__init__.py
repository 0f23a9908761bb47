"""File formats behind ``adaptsize.io``: one file per family."""

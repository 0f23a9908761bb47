"""Methods of `SimplexMesh` that are implemented further up, by subject.

Each imports its function when it is called.  `pyproject.toml` lists these imports.
"""

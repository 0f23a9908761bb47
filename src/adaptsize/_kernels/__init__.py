"""Compiled loops: plain arrays in, arrays filled.  They check nothing; their callers do."""

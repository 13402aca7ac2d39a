"""The page of a consistency assessment, and what it says in a terminal."""

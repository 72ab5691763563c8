"""Lines and crossings (the two things that travel), estimates, casting, errors, execution."""

"""Area, volume, moments and their errors."""

"""Where lines come from: sequences, models, enclosing bodies. Arrays in, arrays out."""

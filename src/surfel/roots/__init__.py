"""Real roots of polynomials in one variable: of quadratics, quartics, and of any degree."""

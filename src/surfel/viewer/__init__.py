"""The browser application: solids that can be moved, and what comes out of it, beside them."""

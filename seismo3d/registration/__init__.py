"""Registration: one quadratic form, exact solvers on it, a certificate, and the fused loop around them."""

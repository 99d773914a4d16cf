//! Time, quantities with units, and named settings.

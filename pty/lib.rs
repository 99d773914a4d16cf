//! Pseudo-terminals and serial ports: the only crate with system calls.

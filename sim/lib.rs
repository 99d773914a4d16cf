//! Firmware emulators, the serial line, and the rig that ties them to the world.

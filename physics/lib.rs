//! The world outside the firmware: bodies, tyres, motors, battery, rails.

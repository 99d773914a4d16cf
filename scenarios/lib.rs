//! Scenario files: scripted faults, judged.

//! The tour: everything once, with a report.

//! A DTM judged against a truth.

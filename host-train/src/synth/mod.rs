//! The synthetic Moon: terrain, photometry, scenes.

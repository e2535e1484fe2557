//! PNG pictures: hillshades, error maps, curves.

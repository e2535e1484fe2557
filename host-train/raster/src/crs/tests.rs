//! Systems and their keys.

use super::*;
use elunar_core::sun::Body;

#[test]
fn systems_have_their_sphere() {
    for crs in [
        Crs::equirectangular(Body::Moon.radius_m(), 12.0, 180.0),
        Crs::polar(Body::Moon.radius_m(), true),
        Crs::polar(Body::Moon.radius_m(), false),
    ] {
        assert!(crs.is_projected() && !crs.is_empty() && !crs.pixel_is_point());
        assert_eq!(crs.sphere_radius_m(), Some(Body::Moon.radius_m()));
        assert_eq!(crs.metres_per_unit(), Some(1.0));
        assert_eq!(crs.defect(), None);
        assert!(crs.directory[4..].chunks(4).is_sorted_by_key(|k| k[0]), "keys ascend");
    }
    assert_eq!(Crs::default().sphere_radius_m(), None);
    assert!(!Crs::default().is_projected());
}

#[test]
fn sameness_is_of_meaning() {
    let a = Crs::equirectangular(Body::Moon.radius_m(), 0.0, 180.0);
    let mut b = Crs::equirectangular(Body::Moon.radius_m(), 0.0, -180.0);
    assert!(a.same_as(&b), "a meridian has many names");
    b.ascii = b.ascii.replace("Equirectangular Moon", "equirectangular_moon");
    assert!(a.same_as(&b), "citations are comments");
    assert!(!a.same_as(&Crs::equirectangular(Body::Moon.radius_m(), 1.0, 180.0)), "the standard parallel matters");
    assert!(!a.same_as(&Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0)), "the meridian matters");
    assert!(
        !a.same_as(&Crs::polar(Body::Moon.radius_m(), true))
            && !Crs::polar(Body::Moon.radius_m(), false).same_as(&Crs::polar(Body::Moon.radius_m(), true))
    );
    assert!(!a.same_as(&Crs::default()) && Crs::default().same_as(&Crs::default()));
    let mut other_sphere = a.clone();
    other_sphere.doubles[0] = 1_738_000.0;
    other_sphere.doubles[1] = 1_738_000.0;
    assert!(!a.same_as(&other_sphere), "the radius matters");
}

#[test]
fn synonyms_and_defaults_are_folded() {
    let a = Crs::equirectangular(Body::Moon.radius_m(), 0.0, 25.0);
    let mut b = a.clone();
    // Entry of the central meridian. Its key becomes the synonym of other writers, and the zeros are left to their defaults.
    let at = b.directory[4..].chunks(4).position(|entry| entry[0] == key::CENTRE_LON).unwrap() * 4 + 4;
    b.directory[at] = key::NAT_ORIGIN_LON;
    let kept: Vec<u16> = b.directory[4..]
        .chunks(4)
        .filter(|entry| ![key::STD_PARALLEL_1, key::FALSE_EASTING, key::CENTRE_LAT].contains(&entry[0]))
        .flatten()
        .copied()
        .collect();
    b.directory = [vec![1, 1, 0, (kept.len() / 4) as u16], kept].concat();
    assert!(a.same_as(&b) && b.directory.len() < a.directory.len());
    assert_eq!(a.meaning(), b.meaning());
}

#[test]
fn contradictory_tags_are_found() {
    let mut crs = Crs::polar(Body::Moon.radius_m(), true);
    crs.doubles.pop();
    assert!(crs.defect().unwrap().contains("3095"));
    assert!(Crs { directory: vec![1, 1, 0, 9], ..Crs::default() }.defect().is_some());
    assert!(Crs { directory: vec![1], ..Crs::default() }.defect().is_some());
    assert!(Crs { directory: vec![7, 1, 0, 0], ..Crs::default() }.defect().is_some());
}

#[test]
fn keys_of_systems_that_are_not_supported_are_compared() {
    // Degrees or radians on a sphere with a meridian of its own; further keys of one number or more.
    let of = |unit: u16, more: &[(u16, &[f64])]| {
        let mut crs = Crs {
            directory: vec![1, 1, 0, 4, 1024, 0, 1, 2, 2054, 0, 1, unit, 2057, 34736, 1, 0, 2061, 34736, 1, 1],
            doubles: vec![1_737_400.0, 5.0],
            ascii: String::new(),
        };
        for (key, values) in more {
            crs.directory.extend([*key, 34736, values.len() as u16, crs.doubles.len() as u16]);
            crs.directory[3] += 1;
            crs.doubles.extend(*values);
        }
        assert!(crs.defect().is_none() && Projection::of(&crs).is_none());
        crs
    };
    let (degrees, radians) = (of(9102, &[]), of(9101, &[]));
    assert!(degrees.same_as(&of(9122, &[])) && radians.same_as(&of(9101, &[])) && !degrees.same_as(&radians));
    let of = |more: &[(u16, &[f64])]| of(9101, more);
    assert!(of(&[(4000, &[1.0])]).same_as(&of(&[(4000, &[1.0])])));
    assert!(!of(&[(4000, &[1.0])]).same_as(&of(&[(4001, &[1.0])])), "another key");
    assert!(!of(&[(4000, &[1.0])]).same_as(&of(&[(4000, &[1.0, 1.0])])), "another count");
    assert!(!of(&[(4000, &[1.0])]).same_as(&of(&[(4000, &[1.5])])), "another number");
}

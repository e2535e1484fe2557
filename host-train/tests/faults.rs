//! A short fault campaign on the shipped model. For the long one, there is a command; see the documents of the flight library.

use elunar_scene::predict::int8;
use host_train::faults::{
    Campaign, CampaignResults, FaultOutcome, InjectionTarget, Moments, StripCampaign, markdown, run, run_strip,
};
use std::collections::BTreeSet;
use std::path::Path;

const INJECTIONS: u64 = 7 * 48;

fn campaign(protected: bool, threads: usize) -> CampaignResults {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/nano.eld");
    let model = int8::open(&path).unwrap();
    let moments = Moments::record(&model, 3, 16, protected).unwrap();
    run(&model, &moments, &Campaign { injections: INJECTIONS, seed: 3, threads }, None, || {}).unwrap()
}

#[test]
fn what_is_protected_is_never_silently_wrong() {
    let results = campaign(true, 2);
    eprintln!("{}", markdown(&results));
    let all = results.all();
    assert_eq!(all.all(), INJECTIONS);
    assert_eq!((all.of(FaultOutcome::Hang), all.of(FaultOutcome::Crash)), (0, 0));
    for target in InjectionTarget::ALL {
        let counts = results.of(target);
        assert!(counts.all() > 20, "{}: {} injections", target.name(), counts.all());
        if target.is_model() {
            assert_eq!(counts.of(FaultOutcome::Reported), counts.all(), "{}", target.name());
        } else if target != InjectionTarget::Place {
            assert_eq!(counts.of(FaultOutcome::Silent), 0, "{}", target.name());
        }
    }
    assert!(
        results.of(InjectionTarget::Maps).of(FaultOutcome::Recovered) > 0,
        "maps that are still wanted are found changed"
    );
    // The same seed gives the same injections, with any number of threads.
    assert_eq!(markdown(&campaign(true, 1)), markdown(&results));
}

#[test]
fn bits_flip_in_every_kind_of_operator() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/nano.eld");
    let opened = int8::open(&path).unwrap();
    let (model, moments) = (opened.model(), Moments::record(&opened, 3, 2, true).unwrap());
    let entries = (0..model.entry_count()).filter_map(|entry| model.entry(entry));
    let kinds: BTreeSet<_> = entries.filter_map(|entry| model.operator(entry.operator)).map(|o| o.name()).collect();
    let mut hit: BTreeSet<_> = moments.moments.iter().map(|moment| moment.operator).collect();
    assert!(hit.remove("verification"), "while the model is compared");
    assert_eq!(hit, kinds);
}

#[test]
fn without_protection_the_campaign_sees_what_it_is_for() {
    let results = campaign(false, 2);
    let silent = |target| results.of(target).of(FaultOutcome::Silent);
    assert!(silent(InjectionTarget::Constants) + silent(InjectionTarget::Maps) > 0, "{}", markdown(&results));
}

#[test]
fn no_bit_of_a_strips_memory_changes_heights_silently() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/nano.eld");
    let model = int8::open(&path).unwrap();
    let strip = StripCampaign::record(&model, 3, 40).unwrap();
    let results = run_strip(&strip, &Campaign { injections: 120, seed: 3, threads: 2 }, None, || {}).unwrap();
    eprintln!("{}", markdown(&results));
    let all = results.all();
    let [silent, hang, crash] = [FaultOutcome::Silent, FaultOutcome::Hang, FaultOutcome::Crash].map(|o| all.of(o));
    assert_eq!((all.all(), silent, hang, crash), (120, 0, 0, 0));
    for target in InjectionTarget::STRIP {
        assert_eq!(results.of(target).all(), 20, "{}", target.name());
    }
    let told = all.of(FaultOutcome::Recovered) + all.of(FaultOutcome::Reported);
    assert!(told > 20, "{told}");
}

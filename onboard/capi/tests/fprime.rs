//! The F´ component of `onboard/fprime`, as text: it needs F´ to be compiled. See `onboard/docs/fprime.md` for what ran.

mod common;
use common::repository;

fn text(path: &str) -> String {
    std::fs::read_to_string(repository().join("onboard").join(path)).unwrap()
}

/// Returns what stands between two texts.
fn between<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let start = text.find(from).unwrap_or_else(|| panic!("{from}: not there")) + from.len();
    &text[start..start + text[start..].find(to).unwrap()]
}

/// The component casts states of the service to those of its model: they must be the same, in the same order.
#[test]
fn states_are_those_of_the_service() {
    let model = text("fprime/Terrain/Terrain.fpp");
    let states: Vec<&str> = between(&model, "enum State {", "}").split(',').map(str::trim).collect();
    let header = text("capi/examples/service.h");
    let service = &header[..header.find("} service_state_t;").unwrap()];
    let service: Vec<&str> = service[service.rfind("typedef enum {").unwrap()..]
        .lines()
        .filter_map(|line| line.trim().strip_prefix("SERVICE_"))
        .map(|line| line.split([',', ' ']).next().unwrap())
        .collect();
    assert_eq!(service.len(), 8, "{service:?}");
    assert_eq!(states, service);
}

/// Every counter of the library goes into a channel that the model has.
#[test]
fn every_counter_has_a_channel() {
    let header = text("capi/include/elunar.h");
    let structure = &header[..header.find("} eld_telemetry_t;").unwrap()];
    let fields: Vec<&str> = structure[structure.rfind("typedef struct {").unwrap()..]
        .lines()
        .filter_map(|line| line.trim().strip_suffix(';')?.split_once(' ').map(|found| found.1))
        .filter(|field| *field != "struct_bytes")
        .collect();
    assert!(fields.len() > 15, "{fields:?}");
    let (model, code) = (text("fprime/Terrain/Terrain.fpp"), text("fprime/Terrain/Terrain.cpp"));
    for field in fields {
        let call = code.lines().find(|line| line.contains(&format!("(c.{field});")));
        let call = call.unwrap_or_else(|| panic!("{field}: not sent"));
        let channel = between(call, "tlmWrite_", "(");
        assert!(model.contains(&format!("telemetry {channel}: ")), "{channel}: not in the model");
    }
}

/// A model that cannot be had is tried as seldom as by the cFS application.
#[test]
fn retries_are_those_of_the_cfs_application() {
    let most = |text: &str, name: &str| {
        let line = text.lines().find(|line| line.contains(name) && !line.contains("ifndef")).unwrap();
        line.split([' ', 'u', ';']).rev().find_map(|word| word.parse::<u32>().ok()).unwrap()
    };
    let ticks = most(&text("fprime/Terrain/Terrain.cpp"), "RETRY_TICKS =");
    assert_eq!(ticks, most(&text("cfs/config/default_elunar_app_platform_cfg.h"), "ELUNAR_APP_RETRY_WAKEUPS"));
}

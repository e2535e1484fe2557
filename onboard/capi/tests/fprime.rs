//! The F´ components of `onboard/fprime`, as text: they need F´ to be compiled. See `onboard/docs/fprime.md` for what ran.

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

/// Returns the names of an enumeration in C that is declared last before its type's name, without their prefix.
fn enumeration<'a>(header: &'a str, name: &str, prefix: &str) -> Vec<&'a str> {
    let header = &header[..header.find(&format!("}} {name};")).unwrap()];
    header[header.rfind("typedef enum {").unwrap()..]
        .lines()
        .filter_map(|line| line.trim().strip_prefix(prefix))
        .map(|line| line.split([',', ' ']).next().unwrap())
        .collect()
}

/// The components cast states of the services to those of their models: they must be the same, in the same order.
#[test]
fn states_are_those_of_the_services() {
    for (model, what, header, name, prefix, number) in [
        ("Terrain", "enum State {", "service.h", "service_state_t", "SERVICE_", 8),
        ("Strip", "enum StripState {", "strip_service.h", "strip_state_t", "STRIP_", 5),
    ] {
        let model = text(&format!("fprime/{model}/{model}.fpp"));
        let states: Vec<&str> = between(&model, what, "}").split(',').map(str::trim).collect();
        let header = text(&format!("capi/examples/{header}"));
        let service = enumeration(&header, name, prefix);
        assert_eq!(service.len(), number, "{service:?}");
        assert_eq!(states, service);
    }
}

/// A format of pixels in a command has the number of the library's.
#[test]
fn formats_are_those_of_the_library() {
    let (model, header) = (text("fprime/Strip/Strip.fpp"), text("capi/include/elunar.h"));
    let formats = between(&model, "enum PixelFormat {", "}").split(',').map(str::trim);
    let library = ["F32", "U8", "U16_LE", "U16_BE", "U12_PACKED"];
    for (number, (format, name)) in formats.zip(library).enumerate() {
        assert!(header.contains(&format!("#define ELD_PIXELS_{name} {number}\n")), "{name}");
        assert!(format == name || ["FLOAT", "BYTE"][number] == format, "{format}");
    }
}

/// Every counter of the library goes into a channel that the model has.
#[test]
fn every_counter_has_a_channel() {
    let header = text("capi/include/elunar.h");
    for (component, name) in [("Terrain", "eld_telemetry_t"), ("Strip", "eld_strip_telemetry_t")] {
        let structure = &header[..header.find(&format!("}} {name};")).unwrap()];
        let fields: Vec<&str> = structure[structure.rfind("typedef struct {").unwrap()..]
            .lines()
            .filter_map(|line| line.trim().strip_suffix(';')?.split_once(' ').map(|found| found.1))
            .filter(|field| *field != "struct_bytes")
            .collect();
        assert!(fields.len() > 15, "{fields:?}");
        let [model, code] = ["fpp", "cpp"].map(|end| text(&format!("fprime/{component}/{component}.{end}")));
        for field in fields {
            let call = code.lines().find(|line| line.contains(&format!("(c.{field});")));
            let call = call.unwrap_or_else(|| panic!("{field}: not sent"));
            let channel = between(call, "tlmWrite_", "(");
            assert!(model.contains(&format!("telemetry {channel}: ")), "{channel}: not in the model");
        }
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

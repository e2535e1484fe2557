//! `libelunar.a` for C tests on the host: the functions of `elunar-capi` with the panic handler of `std`.

pub use elunar_capi::ffi;

// GoogleTests of Strip. ELUNAR_ROOT in the environment: this repository, whose model and tile they read. strip.f32: the tile's heights as a strip.
#include "StripTester.hpp"
#include <cmath>
#include <cstdio>
#include <cstdlib>
namespace Elunar {
static U64 s_memory[(4u << 20) / 8u];
static U8 s_model[6u << 20];
static const U32 ROWS = 256, COLS = 320, PX = ROWS * COLS;
static U8 s_pixels[COLS * 4];
static F32 s_line[COLS], s_map[PX];
static U8 s_valid[PX];
static size_t slurp(const char* name, void* to, size_t bytes) {
    const char* const root = std::getenv("ELUNAR_ROOT");
    char path[512];
    (void)std::snprintf(path, sizeof path, "%s/%s", root == nullptr ? "ELUNAR_ROOT" : root, name);
    FILE* f = std::fopen(path, "rb");
    EXPECT_NE(f, nullptr) << path;
    const size_t found = f == nullptr ? 0 : std::fread(to, 1, bytes, f);
    if (f != nullptr) (void)std::fclose(f);
    return found;
}
static void spill(const char* name, const void* from, size_t bytes) {
    FILE* f = std::fopen(name, "wb");
    ASSERT_NE(f, nullptr) << name;
    ASSERT_EQ(std::fwrite(from, 1, bytes, f), bytes);
    (void)std::fclose(f);
}
//! Writes a map of the golden tile with voids as NaN.
static void spillMap(const char* from, const char* to) {
    ASSERT_EQ(slurp(from, s_map, sizeof s_map), sizeof s_map);
    for (U32 i = 0; i < PX; i++) {
        if (s_valid[i] == 0) s_map[i] = NAN;
    }
    spill(to, s_map, sizeof s_map);
}
static long length(const char* name) {
    FILE* f = std::fopen(name, "rb");
    if (f == nullptr) return -1;
    (void)std::fseek(f, 0, SEEK_END);
    const long bytes = std::ftell(f);
    (void)std::fclose(f);
    return bytes;
}
StripTester ::StripTester() : StripGTestBase("StripTester", StripTester::MAX_HISTORY_SIZE), component("Strip") {
    this->initComponents();
    this->connectPorts();
    strip_memory_t memory;
    memory.strip = s_memory;
    memory.strip_bytes = sizeof s_memory;
    memory.model = s_model;
    memory.model_bytes = slurp("host-train/models/nano.eld", s_model, sizeof s_model);
    memory.pixels = s_pixels;
    memory.pixels_bytes = sizeof s_pixels;
    memory.line_m = s_line;
    memory.line_len = COLS;
    this->component.configure(memory);
    this->paramSet_STEP_BUDGET_MACS(200000000u, Fw::ParamValid::VALID);
    this->paramSet_OVERLAP_PX(100u, Fw::ParamValid::VALID);
    this->component.loadParameters();
    EXPECT_EQ(slurp("tests/golden/flight_tile/valid.u8", s_valid, sizeof s_valid), sizeof s_valid);
    spillMap("tests/golden/flight_tile/image.f32", "image.f32");
    spillMap("tests/golden/flight_tile/coarse_m.f32", "coarse_m.f32");
    (void)std::remove("strip.f32");
}
StripTester ::~StripTester() {}
void StripTester ::make(const char* coarse, U32 cols, U32 postCols) {
    this->sendCmd_MAKE(0, 1, Fw::CmdStringArg("image.f32"), Fw::CmdStringArg(coarse), Fw::CmdStringArg("strip.f32"), PixelFormat::FLOAT, cols,
                       postCols, 1.5f, 1.5f, 2.0f, 29.61f, 189.488525f, 25.614722f);
    (void)this->component.doDispatch();
}
void StripTester ::tickWhileMaking() {
    for (U32 n = 0; n < 3000 && (this->component.m_service.state == STRIP_CHECK || this->component.m_service.state == STRIP_WORK); n++) {
        this->invoke_to_tick(0, 0);
        (void)this->component.doDispatch();
    }
}
void StripTester ::made() {
    this->make("coarse_m.f32", COLS, 0);
    ASSERT_CMD_RESPONSE(0, Strip::OPCODE_MAKE, 1, Fw::CmdResponse::OK);
    ASSERT_EVENTS_StripBegun(0, COLS);
    this->tickWhileMaking();
    ASSERT_EVENTS_StripReady_SIZE(1);
    ASSERT_EVENTS_StripReady(0, ROWS, 0);
    ASSERT_EQ(length("strip.f32"), static_cast<long>(PX * sizeof(F32)));
    for (U32 n = 0; n < 16; n++) {
        this->invoke_to_tick(0, 0);
        (void)this->component.doDispatch();
    }
    ASSERT_EQ(this->tlmHistory_Tiles->at(this->tlmHistory_Tiles->size() - 1).arg, 1u);
    this->invoke_to_pingIn(0, 7);
    (void)this->component.doDispatch();
    ASSERT_from_pingOut(0, 7u);
}
void StripTester ::madeFromPosts() {
    F32 posts[12][14];
    for (U32 i = 0; i < 12 * 14; i++) posts[i / 14][i % 14] = -1900.0f + static_cast<F32>((i / 14 * 5 + i % 14 * 7) % 13);
    spill("posts.f32", posts, sizeof posts);
    this->make("posts.f32", COLS, 14);
    this->tickWhileMaking();
    ASSERT_EVENTS_StripReady(0, ROWS, 0);
    ASSERT_EQ(length("strip.f32"), static_cast<long>(PX * sizeof(F32)));
}
void StripTester ::refusedAndBroken() {
    this->make("coarse_m.f32", COLS + 1, 0);
    ASSERT_CMD_RESPONSE(0, Strip::OPCODE_MAKE, 1, Fw::CmdResponse::VALIDATION_ERROR);
    this->make("missing.f32", COLS, 0);
    ASSERT_CMD_RESPONSE(1, Strip::OPCODE_MAKE, 1, Fw::CmdResponse::EXECUTION_ERROR);
    ASSERT_EVENTS_FileRefused_SIZE(1);
    // A coarse DTM that ends before the image: the file of heights is removed.
    spill("short.f32", s_map, sizeof s_map / 2 + 10);
    this->make("short.f32", COLS, 0);
    this->tickWhileMaking();
    ASSERT_EVENTS_FileFailed_SIZE(1);
    ASSERT_EVENTS_StripFailed_SIZE(1);
    ASSERT_EQ(length("strip.f32"), -1);
    // A model that changed while no strip was made.
    s_model[3000000] ^= 4;
    this->make("coarse_m.f32", COLS, 0);
    this->tickWhileMaking();
    s_model[3000000] ^= 4;
    ASSERT_EVENTS_StripFailed_SIZE(2);
    this->make("coarse_m.f32", COLS, 0);
    this->sendCmd_ABORT(0, 2);
    (void)this->component.doDispatch();
    ASSERT_CMD_RESPONSE(5, Strip::OPCODE_ABORT, 2, Fw::CmdResponse::OK);
    ASSERT_EQ(this->component.m_service.state, STRIP_NONE);
    ASSERT_EQ(length("strip.f32"), -1);
}
}  // namespace Elunar

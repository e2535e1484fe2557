// GoogleTests of Terrain. ELUNAR_ROOT in the environment: this repository, whose model and tile they read. heights.bin: the tile's heights.
#include "TerrainTester.hpp"
#include <cstdio>
#include <cstdlib>
namespace Elunar {
static U64 s_memory[(9u << 18) / 8u];
static U8 s_model[6u << 20];
static const U32 PX = 256u * 320u;
static F32 s_image[PX], s_coarse[PX], s_heights[PX * 5 / 4];
static void slurp(const char* folder, const char* name, void* to, size_t bytes) {
    char path[512];
    (void)std::snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE* f = std::fopen(path, "rb");
    ASSERT_NE(f, nullptr) << path;
    ASSERT_EQ(std::fread(to, 1, bytes, f), bytes);
    (void)std::fclose(f);
}
static const char* root() {
    const char* const found = std::getenv("ELUNAR_ROOT");
    return found == nullptr ? "ELUNAR_ROOT" : found;
}
TerrainTester ::TerrainTester() : TerrainGTestBase("TerrainTester", TerrainTester::MAX_HISTORY_SIZE), component("Terrain") {
    this->initComponents();
    this->connectPorts();
    static char path[512];
    (void)std::snprintf(path, sizeof path, "%s/host-train/models/nano.eld", root());
    EXPECT_TRUE(this->component.configure(s_memory, sizeof s_memory, s_model, sizeof s_model, path));
    this->paramSet_STEP_BUDGET_MACS(200000000u, Fw::ParamValid::VALID);
    this->paramSet_SCRUB_BYTES(16384u, Fw::ParamValid::VALID);
    this->component.loadParameters();
    char folder[512];
    (void)std::snprintf(folder, sizeof folder, "%s/tests/golden/flight_tile", root());
    slurp(folder, "image.f32", s_image, sizeof s_image);
    slurp(folder, "coarse_m.f32", s_coarse, sizeof s_coarse);
}
TerrainTester ::~TerrainTester() {}
Fw::Buffer TerrainTester ::from_heightsAllocate_handler(FwIndexType, U32 size) {
    EXPECT_LE(size, sizeof s_heights);
    return Fw::Buffer(reinterpret_cast<U8*>(s_heights), size);
}
void TerrainTester ::tick() {
    this->invoke_to_tick(0, 0);
    (void)this->component.doDispatch();
}
U32 TerrainTester ::tickUntil(service_state_t state) {
    U32 n = 0;
    while (this->component.m_service.state != state && n < 500) { this->tick(); n++; }
    EXPECT_EQ(this->component.m_service.state, state);
    return n;
}
void TerrainTester ::selfTestThenTile() {
    // The model is validated in pieces, one a tick.
    ASSERT_EVENTS_Started_SIZE(0);
    ASSERT_GE(this->tickUntil(SERVICE_SELF_TEST), 2u);
    ASSERT_EVENTS_Started_SIZE(1);
    (void)this->tickUntil(SERVICE_IDLE);
    ASSERT_EVENTS_SelfTestPassed_SIZE(1);
    Fw::Buffer image(reinterpret_cast<U8*>(s_image), sizeof s_image), coarse(reinterpret_cast<U8*>(s_coarse), sizeof s_coarse);
    this->invoke_to_tileIn(0, image, coarse, 2.0f, 29.61f, 189.488525f, 25.614722f);
    (void)this->component.doDispatch();
    ASSERT_EVENTS_TileBegun_SIZE(1);
    (void)this->tickUntil(SERVICE_READY);
    this->tick();
    ASSERT_EVENTS_TileReady_SIZE(1);
    ASSERT_from_heightsOut_SIZE(1);
    ASSERT_from_imageReturn_SIZE(1);
    ASSERT_from_coarseReturn_SIZE(1);
    FILE* f = std::fopen("heights.bin", "wb");
    ASSERT_NE(f, nullptr);
    (void)std::fwrite(s_heights, 1, PX * 5, f);
    (void)std::fclose(f);
    for (U32 i = 0; i < 16; i++) this->tick();
    ASSERT_TRUE(this->tlmHistory_Tiles->size() > 0);
    this->invoke_to_pingIn(0, 7);
    (void)this->component.doDispatch();
    ASSERT_from_pingOut(0, 7u);
}
void TerrainTester ::busyAndRefused() {
    Fw::Buffer image(reinterpret_cast<U8*>(s_image), sizeof s_image), coarse(reinterpret_cast<U8*>(s_coarse), sizeof s_coarse);
    this->invoke_to_tileIn(0, image, coarse, 2.0f, 29.61f, 0.0f, 30.0f);
    (void)this->component.doDispatch();
    ASSERT_EVENTS_Busy_SIZE(1);
    ASSERT_from_imageReturn_SIZE(1);
    (void)this->tickUntil(SERVICE_IDLE);
    Fw::Buffer shortImage(reinterpret_cast<U8*>(s_image), sizeof s_image - 4);
    this->invoke_to_tileIn(0, shortImage, coarse, 2.0f, 29.61f, 0.0f, 30.0f);
    (void)this->component.doDispatch();
    ASSERT_EVENTS_TileDropped_SIZE(1);
    ASSERT_from_imageReturn_SIZE(2);
    this->sendCmd_SCRUB(0, 1, 65537);
    (void)this->component.doDispatch();
    ASSERT_CMD_RESPONSE(0, Terrain::OPCODE_SCRUB, 1, Fw::CmdResponse::VALIDATION_ERROR);
    this->sendCmd_SELF_TEST(0, 2);
    (void)this->component.doDispatch();
    ASSERT_CMD_RESPONSE(1, Terrain::OPCODE_SELF_TEST, 2, Fw::CmdResponse::OK);
}
void TerrainTester ::upset() {
    (void)this->tickUntil(SERVICE_IDLE);
    s_model[3000000] ^= 4;
    (void)this->tickUntil(SERVICE_WANTS_MODEL);
    // While the file is missing it is tried ever more seldom: at ticks 1, 3, 6, 11, 20, 37 and 70.
    const char* const path = this->component.m_modelPath;
    this->component.m_modelPath = "/missing.eld";
    for (U32 i = 0; i < 100; i++) this->tick();
    ASSERT_EQ(this->component.m_service.state, SERVICE_WANTS_MODEL);
    ASSERT_EQ(this->component.m_retryNext, 64u);
    this->component.m_modelPath = path;
    (void)this->tickUntil(SERVICE_CHECK);
    (void)this->tickUntil(SERVICE_SELF_TEST);
    ASSERT_EVENTS_ModelReloaded_SIZE(1);
    (void)this->tickUntil(SERVICE_IDLE);
}
}  // namespace Elunar

// The service of onboard/capi/examples as a component of F´: see onboard/docs/fprime.md.
#include "Terrain/Terrain.hpp"
#include <FpConfig.hpp>
#include <Os/File.hpp>
#include <cstring>

namespace Elunar {

static const U32 TELEMETRY_TICKS = 16;
//! Largest number of ticks between two tries of a model that cannot be had: it is tried at the next tick, then after 2, 4, 8 ...
static const U32 RETRY_TICKS = 1000;

Terrain ::Terrain(const char* const compName)
    : TerrainComponentBase(compName), m_memory(nullptr), m_memoryBytes(0), m_model(nullptr), m_modelCapacity(0), m_modelBytes(0),
      m_modelPath(nullptr), m_hasBuffers(false), m_dropsTold(0), m_again(false), m_ticks(0), m_retryWait(0), m_retryNext(0) {
    (void)::memset(&this->m_service, 0, sizeof this->m_service);
}

Terrain ::~Terrain() {}

bool Terrain ::load() {
    Os::File file;
    if (file.open(this->m_modelPath, Os::File::OPEN_READ) != Os::File::OP_OK) {
        return false;
    }
    FwSignedSizeType bytes = this->m_modelCapacity;
    const Os::File::Status status = file.read(this->m_model, bytes, Os::File::WAIT);
    file.close();
    this->m_modelBytes = static_cast<U32>(bytes);
    return status == Os::File::OP_OK;
}

bool Terrain ::start() {
    if (eld_version() >> 16 != ELD_VERSION >> 16 || !this->load()) {
        return false;
    }
    this->m_again = false;
    // The heights of a tile go into a buffer of its size: no tile is too large.
    this->tell(service_start(&this->m_service, this->m_memory, this->m_memoryBytes, this->m_model, this->m_modelBytes, SIZE_MAX));
    return this->m_service.state != SERVICE_DOWN;
}

bool Terrain ::configure(void* memory, size_t memoryBytes, U8* model, U32 modelCapacity, const char* modelPath) {
    this->m_memory = memory;
    this->m_memoryBytes = memoryBytes;
    this->m_model = model;
    this->m_modelCapacity = modelCapacity;
    this->m_modelPath = modelPath;
    return this->start();
}

void Terrain ::tell(eld_status_t status) {
    if (status == ELD_OK || status == ELD_RUNNING) {
        return;
    }
    const Fw::LogStringArg meaning(eld_status_text(status));
    if (ELD_WORKED(status)) {
        this->log_ACTIVITY_LO_Notice(status, meaning);
    } else {
        this->log_WARNING_HI_Fault(status, meaning);
    }
}

void Terrain ::giveBack() {
    if (this->m_hasBuffers) {
        this->m_hasBuffers = false;
        this->imageReturn_out(0, this->m_image);
        this->coarseReturn_out(0, this->m_coarse);
    }
}

void Terrain ::settle(service_state_t before) {
    if (this->m_service.drops != this->m_dropsTold) {
        this->m_dropsTold = this->m_service.drops;
        const Fw::LogStringArg meaning(eld_status_text(this->m_service.status));
        this->log_WARNING_LO_TileDropped(meaning);
        this->giveBack();
    }
    if (before == SERVICE_CHECK && this->m_service.state == SERVICE_SELF_TEST) {
        if (this->m_again) {
            this->log_ACTIVITY_HI_ModelReloaded();
        } else {
            this->log_ACTIVITY_HI_Started(eld_version(), this->m_service.info.header_crc, this->m_service.info.memory_bytes);
        }
    } else if (this->m_service.state == SERVICE_FAILED && before != SERVICE_FAILED) {
        this->log_WARNING_HI_SelfTestFailed();
    } else if (before == SERVICE_SELF_TEST && (this->m_service.state == SERVICE_IDLE || this->m_service.state == SERVICE_TILE)) {
        this->log_ACTIVITY_HI_SelfTestPassed();
    }
    this->tlmWrite_ServiceState(static_cast<State::T>(this->m_service.state));
}

void Terrain ::take() {
    const U32 px = this->m_service.info.tile_rows * this->m_service.info.tile_cols;
    Fw::Buffer heights = this->heightsAllocate_out(0, px * 5);
    if (heights.getData() == nullptr || heights.getSize() < px * 5) {
        return;  // Tried again at the next tick.
    }
    // The library refuses a buffer that is not aligned for floats.
    const eld_status_t status = service_take(&this->m_service, reinterpret_cast<float*>(heights.getData()), heights.getData() + px * 4);
    this->tell(status);
    if (ELD_WORKED(status)) {
        eld_telemetry_t counters;
        counters.struct_bytes = sizeof counters;
        const bool known = ELD_WORKED(eld_telemetry(this->m_service.context, &counters));
        this->log_ACTIVITY_HI_TileReady(known ? counters.valid_px : 0);
        this->heightsOut_out(0, heights);
        this->giveBack();
    } else {
        this->heightsReturn_out(0, heights);
    }
}

void Terrain ::telemeter() {
    eld_telemetry_t c;
    c.struct_bytes = sizeof c;
    if (this->m_service.context == nullptr || !ELD_WORKED(eld_telemetry(this->m_service.context, &c))) {
        return;
    }
    this->tlmWrite_LastFault(c.last_fault);
    this->tlmWrite_ModelCrc(c.header_crc);
    this->tlmWrite_Calls(c.calls);
    this->tlmWrite_Faults(c.faults);
    this->tlmWrite_ContextRepairs(c.context_repairs);
    this->tlmWrite_LightsAssumed(c.lights_assumed);
    this->tlmWrite_Tiles(c.tiles);
    this->tlmWrite_TilesDropped(c.tiles_dropped);
    this->tlmWrite_Steps(c.steps);
    this->tlmWrite_Macs(c.macs);
    this->tlmWrite_ValidPx(c.valid_px);
    this->tlmWrite_Phase(c.phase);
    this->tlmWrite_ScheduleEntry(c.entry);
    this->tlmWrite_InputsClamped(c.inputs_clamped);
    this->tlmWrite_Saturated(c.saturated);
    this->tlmWrite_ScrubbedBytes(c.scrubbed_bytes);
    this->tlmWrite_ScrubPasses(c.scrub_passes);
    this->tlmWrite_ScrubFaults(c.scrub_faults);
    this->tlmWrite_SelfTestFaults(c.self_test_faults);
    this->tlmWrite_TileFaults(c.tile_faults);
}

bool Terrain ::tryNow() {
    if (this->m_retryWait > 0) {
        this->m_retryWait--;
        return false;
    }
    this->m_retryNext = this->m_retryNext == 0 ? 1 : 2 * this->m_retryNext;
    if (this->m_retryNext > RETRY_TICKS) {
        this->m_retryNext = RETRY_TICKS;
    }
    this->m_retryWait = this->m_retryNext;
    return true;
}

void Terrain ::pingIn_handler(FwIndexType, U32 key) { this->pingOut_out(0, key); }

void Terrain ::tick_handler(FwIndexType, U32) {
    const service_state_t before = this->m_service.state;
    Fw::ParamValid valid;
    switch (before) {
        case SERVICE_DOWN:
            if (this->tryNow()) {
                (void)this->start();
            }
            break;
        case SERVICE_WANTS_MODEL:
            if (this->tryNow() && this->load()) {
                this->m_again = true;
                this->tell(service_model_reloaded(&this->m_service));
            }
            break;
        case SERVICE_READY:
            this->take();
            break;
        case SERVICE_FAILED:
            // Told once, by settle.
            break;
        default: {
            const U32 budget = this->paramGet_STEP_BUDGET_MACS(valid);
            const U32 scrub = this->paramGet_SCRUB_BYTES(valid);
            this->tell(service_cycle(&this->m_service, budget, scrub));
            break;
        }
    }
    if (this->m_service.state == SERVICE_IDLE || this->m_service.state == SERVICE_TILE || this->m_service.state == SERVICE_READY) {
        this->m_retryWait = 0;
        this->m_retryNext = 0;
    }
    this->settle(before);
    if (++this->m_ticks % TELEMETRY_TICKS == 0) {
        this->telemeter();
    }
}

void Terrain ::tileIn_handler(FwIndexType, const Fw::Buffer& image, const Fw::Buffer& coarse, F32 pixel_m, F32 coarse_px, F32 sun_azimuth_deg,
                              F32 sun_elevation_deg) {
    if (this->m_service.state != SERVICE_IDLE) {
        this->log_WARNING_LO_Busy();
        Fw::Buffer one(image), other(coarse);
        this->imageReturn_out(0, one);
        this->coarseReturn_out(0, other);
        return;
    }
    this->m_image = image;
    this->m_coarse = coarse;
    this->m_hasBuffers = true;
    eld_tile_t tile;
    (void)::memset(&tile, 0, sizeof tile);
    tile.struct_bytes = sizeof tile;
    tile.pixel_m = pixel_m;
    tile.coarse_px = coarse_px;
    tile.sun_azimuth_deg = sun_azimuth_deg;
    tile.sun_elevation_deg = sun_elevation_deg;
    tile.image = service_floats(this->m_image.getData(), this->m_image.getSize());
    tile.coarse_m = reinterpret_cast<const float*>(this->m_coarse.getData());
    tile.coarse_len = this->m_coarse.getSize() / sizeof(float);
    const eld_status_t status = service_give(&this->m_service, &tile);
    this->tell(status);
    if (ELD_WORKED(status)) {
        this->log_ACTIVITY_LO_TileBegun();
    }
    this->settle(SERVICE_IDLE);
}

void Terrain ::SELF_TEST_cmdHandler(FwOpcodeType opCode, U32 cmdSeq) {
    const eld_status_t status = service_self_test(&this->m_service);
    if (status == ELD_REFUSED_NOT_DONE) {
        this->log_WARNING_LO_Busy();
    } else {
        this->tell(status);
    }
    this->cmdResponse_out(opCode, cmdSeq, ELD_WORKED(status) ? Fw::CmdResponse::OK : Fw::CmdResponse::EXECUTION_ERROR);
}

void Terrain ::SCRUB_cmdHandler(FwOpcodeType opCode, U32 cmdSeq, U32 bytes) {
    if (bytes == 0 || bytes > 65536) {
        this->cmdResponse_out(opCode, cmdSeq, Fw::CmdResponse::VALIDATION_ERROR);
        return;
    }
    const eld_status_t status = service_scrub(&this->m_service, bytes);
    this->tell(status);
    this->cmdResponse_out(opCode, cmdSeq, ELD_WORKED(status) ? Fw::CmdResponse::OK : Fw::CmdResponse::EXECUTION_ERROR);
}

void Terrain ::RELOAD_MODEL_cmdHandler(FwOpcodeType opCode, U32 cmdSeq) {
    const bool started = this->start();
    this->cmdResponse_out(opCode, cmdSeq, started ? Fw::CmdResponse::OK : Fw::CmdResponse::EXECUTION_ERROR);
}

}  // namespace Elunar

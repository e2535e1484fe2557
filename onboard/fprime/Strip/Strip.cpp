// The strip service of onboard/capi/examples as a component of F´: see onboard/docs/fprime.md.
#include "Strip/Strip.hpp"
#include <FpConfig.hpp>
#include <Os/FileSystem.hpp>
#include <cstring>

namespace Elunar {

static const U32 TELEMETRY_TICKS = 16;

Strip ::Strip(const char* const compName) : StripComponentBase(compName), m_room(0), m_ticks(0) {
    (void)::memset(&this->m_memory, 0, sizeof this->m_memory);
    (void)::memset(&this->m_service, 0, sizeof this->m_service);
}

Strip ::~Strip() {}

void Strip ::configure(const strip_memory_t& memory) {
    this->m_memory = memory;
    this->m_room = memory.pixels_bytes;
}

int Strip ::read(Named& from, void* to, size_t bytes) {
    FwSignedSizeType found = static_cast<FwSignedSizeType>(bytes);
    const Os::File::Status status = from.file.read(static_cast<U8*>(to), found, Os::File::WAIT);
    if (status == Os::File::OP_OK && found == static_cast<FwSignedSizeType>(bytes)) {
        return STRIP_HERE;
    }
    if (status == Os::File::OP_OK && found == 0) {
        return STRIP_END;
    }
    this->log_WARNING_HI_FileFailed(from.name);
    return STRIP_BROKEN;
}

int Strip ::line(void* caller, void* pixels, float* coarseM) {
    Strip* const self = static_cast<Strip*>(caller);
    const int found = self->read(self->m_image, pixels, self->m_memory.pixels_bytes);
    if (found != STRIP_HERE || coarseM == nullptr) {
        return found;
    }
    // An image with fewer lines of the coarse DTM than it has itself is broken.
    const int coarse = self->read(self->m_coarse, coarseM, self->m_service.settings.cols * sizeof(float));
    return coarse == STRIP_HERE ? STRIP_HERE : STRIP_BROKEN;
}

int Strip ::posts(void* caller, float* postsM) {
    Strip* const self = static_cast<Strip*>(caller);
    return self->read(self->m_coarse, postsM, self->m_service.settings.post_cols * sizeof(float));
}

int Strip ::heights(void* caller, uint64_t, const float* heightsM) {
    Strip* const self = static_cast<Strip*>(caller);
    const FwSignedSizeType bytes = static_cast<FwSignedSizeType>(self->m_service.settings.cols * sizeof(float));
    FwSignedSizeType written = bytes;
    const Os::File::Status status = self->m_heights.file.write(reinterpret_cast<const U8*>(heightsM), written, Os::File::WAIT);
    if (status == Os::File::OP_OK && written == bytes) {
        return STRIP_HERE;
    }
    self->log_WARNING_HI_FileFailed(self->m_heights.name);
    return STRIP_BROKEN;
}

bool Strip ::open(Named& one, const Fw::CmdStringArg& name, Os::File::Mode mode) {
    one.name = name;
    if (one.file.open(name.toChar(), mode, Os::File::OVERWRITE) == Os::File::OP_OK) {
        return true;
    }
    this->log_WARNING_LO_FileRefused(name);
    return false;
}

void Strip ::end(bool keep) {
    const bool written = this->m_heights.file.isOpen();
    this->m_image.file.close();
    this->m_coarse.file.close();
    this->m_heights.file.close();
    if (written && !keep) {
        (void)Os::FileSystem::removeFile(this->m_heights.name.toChar());
    }
}

void Strip ::settle(strip_state_t before) {
    const strip_service_t& service = this->m_service;
    if (service.state == STRIP_FAILED && before != STRIP_FAILED) {
        this->log_WARNING_HI_StripFailed(service.status, Fw::LogStringArg(eld_status_text(service.status)));
        this->end(false);
    } else if (service.state == STRIP_DONE && before != STRIP_DONE) {
        eld_strip_telemetry_t c;
        c.struct_bytes = sizeof c;
        const bool known = ELD_WORKED(eld_strip_telemetry(service.strip, &c));
        this->log_ACTIVITY_HI_StripReady(service.lines_out, known ? c.pieces_lost : 0);
        this->end(true);
    }
    this->tlmWrite_StripState(static_cast<StripState::T>(service.state));
}

void Strip ::telemeter() {
    eld_strip_telemetry_t c;
    c.struct_bytes = sizeof c;
    if (this->m_service.strip == nullptr || !ELD_WORKED(eld_strip_telemetry(this->m_service.strip, &c))) {
        return;
    }
    this->tlmWrite_LinesIn(this->m_service.lines_in);
    this->tlmWrite_LinesOut(this->m_service.lines_out);
    this->tlmWrite_LastFault(c.last_fault);
    this->tlmWrite_Ready(c.ready);
    this->tlmWrite_Calls(c.calls);
    this->tlmWrite_Faults(c.faults);
    this->tlmWrite_ContextRepairs(c.context_repairs);
    this->tlmWrite_Tiles(c.tiles);
    this->tlmWrite_TilesCoarse(c.tiles_coarse);
    this->tlmWrite_TilesEmpty(c.tiles_empty);
    this->tlmWrite_TilesAgain(c.tiles_again);
    this->tlmWrite_TilesLost(c.tiles_lost);
    this->tlmWrite_TilesVoid(c.tiles_void);
    this->tlmWrite_MemoryFaults(c.memory_faults);
    this->tlmWrite_PiecesLost(c.pieces_lost);
    this->tlmWrite_Steps(c.steps);
    this->tlmWrite_Macs(c.macs);
    this->tlmWrite_InputsClamped(c.inputs_clamped);
    this->tlmWrite_Saturated(c.saturated);
    this->tlmWrite_ScrubbedBytes(c.scrubbed_bytes);
    this->tlmWrite_ScrubPasses(c.scrub_passes);
    this->tlmWrite_ScrubFaults(c.scrub_faults);
    this->tlmWrite_TileFaults(c.tile_faults);
}

void Strip ::pingIn_handler(FwIndexType, U32 key) { this->pingOut_out(0, key); }

void Strip ::tick_handler(FwIndexType, U32) {
    const strip_state_t before = this->m_service.state;
    Fw::ParamValid valid;
    if (before == STRIP_CHECK || before == STRIP_WORK) {
        (void)strip_cycle(&this->m_service, this->paramGet_STEP_BUDGET_MACS(valid));
    }
    this->settle(before);
    if (++this->m_ticks % TELEMETRY_TICKS == 0) {
        this->telemeter();
    }
}

void Strip ::MAKE_cmdHandler(FwOpcodeType opCode, U32 cmdSeq, const Fw::CmdStringArg& image, const Fw::CmdStringArg& coarse,
                             const Fw::CmdStringArg& heights, Elunar::PixelFormat format, U32 cols, U32 postCols, F32 postRow0, F32 postCol0,
                             F32 pixelM, F32 coarsePx, F32 sunAzimuthDeg, F32 sunElevationDeg) {
    static const size_t HALF_BYTES[] = {8, 2, 4, 4, 3};
    Fw::ParamValid valid;
    this->end(false);
    (void)::memset(&this->m_service, 0, sizeof this->m_service);
    const size_t lineBytes = (static_cast<size_t>(cols) * HALF_BYTES[format.e] + 1) / 2;
    if (lineBytes > this->m_room) {
        this->cmdResponse_out(opCode, cmdSeq, Fw::CmdResponse::VALIDATION_ERROR);
        return;
    }
    this->m_memory.pixels_bytes = lineBytes;
    if (!this->open(this->m_image, image, Os::File::OPEN_READ) || !this->open(this->m_coarse, coarse, Os::File::OPEN_READ) ||
        !this->open(this->m_heights, heights, Os::File::OPEN_CREATE)) {
        this->end(false);
        this->cmdResponse_out(opCode, cmdSeq, Fw::CmdResponse::EXECUTION_ERROR);
        return;
    }
    eld_strip_settings_t settings;
    (void)::memset(&settings, 0, sizeof settings);
    settings.struct_bytes = sizeof settings;
    settings.cols = cols;
    settings.overlap_px = this->paramGet_OVERLAP_PX(valid);
    settings.pixel_m = pixelM;
    settings.coarse_px = coarsePx;
    settings.sun_azimuth_deg = sunAzimuthDeg;
    settings.sun_elevation_deg = sunElevationDeg;
    settings.post_cols = postCols;
    settings.post_row0 = static_cast<double>(postRow0);
    settings.post_rows_per_line = 1.0 / static_cast<double>(coarsePx);
    settings.post_col0 = static_cast<double>(postCol0);
    settings.post_cols_per_px = 1.0 / static_cast<double>(coarsePx);
    settings.pixels.format = static_cast<U32>(format.e);
    settings.pixels.gain = 1.0f;
    const strip_lines_t lines = {Strip::line, Strip::posts, Strip::heights, this};
    const bool begun = ELD_WORKED(strip_begin(&this->m_service, &this->m_memory, &lines, &settings));
    if (begun) {
        this->log_ACTIVITY_LO_StripBegun(cols);
    }
    this->settle(STRIP_NONE);
    this->cmdResponse_out(opCode, cmdSeq, begun ? Fw::CmdResponse::OK : Fw::CmdResponse::EXECUTION_ERROR);
}

void Strip ::ABORT_cmdHandler(FwOpcodeType opCode, U32 cmdSeq) {
    this->end(false);
    (void)::memset(&this->m_service, 0, sizeof this->m_service);
    this->settle(STRIP_NONE);
    this->cmdResponse_out(opCode, cmdSeq, Fw::CmdResponse::OK);
}

}  // namespace Elunar

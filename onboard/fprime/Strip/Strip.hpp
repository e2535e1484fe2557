#ifndef Elunar_Strip_HPP
#define Elunar_Strip_HPP

#include <Os/File.hpp>
#include "Strip/StripComponentAc.hpp"
extern "C" {
#include "strip_service.h"
}

namespace Elunar {

class Strip : public StripComponentBase {
  public:
    explicit Strip(const char* const compName);
    ~Strip();

    //! Lends static memory; before the threads start. The model may be that of Terrain.
    void configure(const strip_memory_t& memory);

    friend class StripTester;

  PRIVATE:
    void pingIn_handler(FwIndexType portNum, U32 key) override;
    void tick_handler(FwIndexType portNum, U32 context) override;
    void MAKE_cmdHandler(FwOpcodeType opCode, U32 cmdSeq, const Fw::CmdStringArg& image, const Fw::CmdStringArg& coarse,
                         const Fw::CmdStringArg& heights, Elunar::PixelFormat format, U32 cols, U32 postCols, F32 postRow0, F32 postCol0, F32 pixelM,
                         F32 coarsePx, F32 sunAzimuthDeg, F32 sunElevationDeg) override;
    void ABORT_cmdHandler(FwOpcodeType opCode, U32 cmdSeq) override;

    //! An open file and its name.
    struct Named {
        Os::File file;
        Fw::CmdStringArg name;
    };
    static int line(void* caller, void* pixels, float* coarseM);
    static int posts(void* caller, float* postsM);
    static int heights(void* caller, uint64_t line, const float* heightsM);
    int read(Named& from, void* to, size_t bytes);
    bool open(Named& one, const Fw::CmdStringArg& name, Os::File::Mode mode);
    void end(bool keep);
    void settle(strip_state_t before);
    void telemeter();

    strip_memory_t m_memory;
    size_t m_room;
    strip_service_t m_service;
    Named m_image, m_coarse, m_heights;
    U32 m_ticks;
};

}  // namespace Elunar
#endif

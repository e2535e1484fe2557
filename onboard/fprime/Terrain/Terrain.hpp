#ifndef Elunar_Terrain_HPP
#define Elunar_Terrain_HPP

#include "Terrain/TerrainComponentAc.hpp"
extern "C" {
#include "service.h"
}

namespace Elunar {

class Terrain : public TerrainComponentBase {
  public:
    explicit Terrain(const char* const compName);
    ~Terrain();

    //! Lends static memory; before the threads start. Ticks validate the model. False: no model, or not this library.
    bool configure(void* memory, size_t memoryBytes, U8* model, U32 modelCapacity, const char* modelPath);

    friend class TerrainTester;

  PRIVATE:
    void pingIn_handler(FwIndexType portNum, U32 key) override;
    void tick_handler(FwIndexType portNum, U32 context) override;
    void tileIn_handler(FwIndexType portNum, const Fw::Buffer& image, const Fw::Buffer& coarse, F32 pixel_m, F32 coarse_px,
                        F32 sun_azimuth_deg, F32 sun_elevation_deg) override;
    void SELF_TEST_cmdHandler(FwOpcodeType opCode, U32 cmdSeq) override;
    void SCRUB_cmdHandler(FwOpcodeType opCode, U32 cmdSeq, U32 bytes) override;
    void RELOAD_MODEL_cmdHandler(FwOpcodeType opCode, U32 cmdSeq) override;

    bool load();
    bool tryNow();
    bool start();
    void tell(eld_status_t status);
    void settle(service_state_t before);
    void giveBack();
    void take();
    void telemeter();

    service_t m_service;
    void* m_memory;
    size_t m_memoryBytes;
    U8* m_model;
    U32 m_modelCapacity;
    U32 m_modelBytes;
    const char* m_modelPath;
    Fw::Buffer m_image, m_coarse;
    bool m_hasBuffers;
    U32 m_dropsTold;
    bool m_again;
    U32 m_ticks;
    U32 m_retryWait;
    U32 m_retryNext;
};

}  // namespace Elunar
#endif

module Elunar {

  @ State of the service: service_state_t
  enum State { DOWN, WANTS_MODEL, SELF_TEST, IDLE, TILE, READY, FAILED, CHECK }

  @ A tile whose maps lie in two buffers: f32 of this machine, first row first
  port Tile(
    image: Fw.Buffer      @< Relative brightness
    coarse: Fw.Buffer     @< Coarse DTM on the image's grid, metres above the 1737.4 km sphere
    pixel_m: F32          @< Ground size of a pixel, metres
    coarse_px: F32        @< Side of a pixel of the coarse DTM, in pixels of the image
    sun_azimuth_deg: F32  @< NaN: unknown
    sun_elevation_deg: F32 @< NaN: unknown
  )

  @ Heights of a tile, then a byte 1 or 0 a pixel
  port Heights(heights: Fw.Buffer)

  @ Heights from images, a step at a time
  active component Terrain {

    @ A tick: one piece of the model's validation, one step of a tile, or one portion of scrubbing
    async input port tick: Svc.Sched drop

    @ A tile; its buffers come back by imageReturn and coarseReturn when it is ready or dropped
    async input port tileIn: Tile

    @ Heights, in a buffer from heightsAllocate; who takes them gives it back
    output port heightsOut: Heights
    output port heightsAllocate: Fw.BufferGet
    @ A buffer from heightsAllocate that could not be filled
    output port heightsReturn: Fw.BufferSend
    output port imageReturn: Fw.BufferSend
    output port coarseReturn: Fw.BufferSend

    @ Health: answered by the thread that works
    async input port pingIn: Svc.Ping
    output port pingOut: Svc.Ping

    @ Begins the self test, when idle
    async command SELF_TEST

    @ Compares some bytes of the model with their checksums at once
    async command SCRUB(bytes: U32 @< 1 to 65536
    )

    @ Loads the model again, and begins anew. Ticks validate it
    async command RELOAD_MODEL

    @ Work of a tick, multiply-accumulates
    param STEP_BUDGET_MACS: U32 default 5000000

    @ Scrubbing of an idle tick, bytes
    param SCRUB_BYTES: U32 default 16384

    @ State of the service
    telemetry ServiceState: State update on change

    @ The latest fault; 0: there was none
    telemetry LastFault: U32 update on change format "0x{x}"

    @ CRC32C of the model's header: its identity
    telemetry ModelCrc: U32 update on change format "0x{x}"

    telemetry Calls: U64
    telemetry Faults: U64 update on change high { red 100 }
    telemetry ContextRepairs: U64 update on change
    telemetry LightsAssumed: U64 update on change
    telemetry Tiles: U64 update on change
    telemetry TilesDropped: U64 update on change
    telemetry Steps: U64
    telemetry Macs: U64
    telemetry ValidPx: U32 update on change
    telemetry Phase: U32 update on change
    telemetry ScheduleEntry: U32
    telemetry InputsClamped: U64 update on change
    telemetry Saturated: U64 update on change
    telemetry ScrubbedBytes: U64
    telemetry ScrubPasses: U64 update on change
    telemetry ScrubFaults: U64 update on change
    telemetry SelfTestFaults: U64 update on change
    telemetry TileFaults: U64 update on change

    @ Model and library are there
    event Started(version: U32, model_crc: U32, memory_bytes: U64) severity activity high \
      format "library {x}, model {x}, {} bytes of memory"

    @ A status of the library that is more than "go on"
    event Notice(status: U32, meaning: string size 80) severity activity low format "0x{x}: {}"
    event Fault(status: U32, meaning: string size 80) severity warning high format "0x{x}: {}" throttle 16

    event TileBegun severity activity low format "tile begun"
    event TileReady(valid_px: U32) severity activity high format "heights of {} pixels"
    event TileDropped(meaning: string size 80) severity warning low format "tile dropped: {}"
    event Busy severity warning low format "not idle"
    event SelfTestPassed severity activity high format "self test passed"
    event SelfTestFailed severity warning high format "self test fails: heights are not to be used"
    event ModelReloaded severity activity high format "model loaded again"

    time get port timeGet
    command recv port cmdIn
    command reg port cmdRegOut
    command resp port cmdResponseOut
    event port eventOut
    text event port textEventOut
    telemetry port tlmOut
    param get port prmGetOut
    param set port prmSetOut

  }

}

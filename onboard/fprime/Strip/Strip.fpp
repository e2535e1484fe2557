module Elunar {

  @ State of a strip: strip_state_t
  enum StripState { NONE, CHECK, WORK, DONE, FAILED }

  @ Pixels of a file: ELD_PIXELS_*
  enum PixelFormat { FLOAT, BYTE, U16_LE, U16_BE, U12_PACKED }

  @ Strips of heights from files, a step at a time
  active component Strip {

    @ A tick: one step of a strip, with at most one line from or to a file
    async input port tick: Svc.Sched drop

    @ Health: answered by the thread that works
    async input port pingIn: Svc.Ping
    output port pingOut: Svc.Ping

    @ Begins a strip. Of another one that is being made nothing remains
    async command MAKE(
      image: string size 80   @< File of pixels, line after line
      coarse: string size 80  @< File of f32 of this machine: rows of posts, or lines on the image's grid, metres above the 1737.4 km sphere
      heights: string size 80 @< File that is written: f32 of this machine, NaN in voids
      $format: PixelFormat    @< Of the image
      cols: U32               @< Pixels of a line
      postCols: U32           @< Posts of a row; 0: the coarse DTM is on the image's grid
      postRow0: F32           @< Row of the posts at the centre of the first line
      postCol0: F32           @< Column of the posts at the centre of the first column
      pixelM: F32             @< Ground size of a pixel, metres
      coarsePx: F32           @< Side of a pixel of the coarse DTM, in pixels of the image
      sunAzimuthDeg: F32      @< NaN: unknown
      sunElevationDeg: F32    @< NaN: unknown
    )

    @ Ends the strip; its file is removed
    async command ABORT

    @ Work of a tick, multiply-accumulates
    param STEP_BUDGET_MACS: U32 default 5000000

    @ Pixels by which two tiles overlap
    param OVERLAP_PX: U32 default 100

    @ State of the strip
    telemetry StripState: StripState update on change

    @ Lines of the image that are taken in, lines of heights that are written
    telemetry LinesIn: U64
    telemetry LinesOut: U64

    @ The latest fault; 0: there was none
    telemetry LastFault: U32 update on change format "0x{x}"

    telemetry Ready: U64
    telemetry Calls: U64
    telemetry Faults: U64 update on change high { red 100 }
    telemetry ContextRepairs: U64 update on change
    telemetry Tiles: U64 update on change
    telemetry TilesCoarse: U64 update on change
    telemetry TilesEmpty: U64 update on change
    telemetry TilesAgain: U64 update on change
    telemetry TilesLost: U64 update on change
    telemetry TilesVoid: U64 update on change
    telemetry MemoryFaults: U64 update on change
    telemetry PiecesLost: U64 update on change
    telemetry Steps: U64
    telemetry Macs: U64
    telemetry InputsClamped: U64 update on change
    telemetry Saturated: U64 update on change
    telemetry ScrubbedBytes: U64
    telemetry ScrubPasses: U64 update on change
    telemetry ScrubFaults: U64 update on change
    telemetry TileFaults: U64 update on change

    event StripBegun(cols: U32) severity activity low format "strip of {} columns begun"
    event StripReady(lines: U64, lost: U64) severity activity high format "{} lines of heights; {} pieces lost"
    event StripFailed(status: U32, meaning: string size 80) severity warning high format "0x{x}: {}"
    event FileRefused(file: string size 80) severity warning low format "cannot be opened: {}"
    event FileFailed(file: string size 80) severity warning high format "cannot be read or written whole: {}"

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

# Headers that other parts of a mission include: schedulers, telemetry tables, ground. In the build's inc/ each is a header that includes the mission's
# own file of this name from its _defs folder, or, if there is none, the default in config/.
foreach(ELUNAR_APP_HEADER fcncodes interface_cfg msg msgdefs msgstruct perfids tbl)
  generate_config_includefile(
    FILE_NAME     "elunar_app_${ELUNAR_APP_HEADER}.h"
    FALLBACK_FILE "${CMAKE_CURRENT_LIST_DIR}/config/default_elunar_app_${ELUNAR_APP_HEADER}.h")
endforeach()

# As mission_build.cmake, for headers that may differ from processor to processor.
foreach(ELUNAR_APP_HEADER msgids platform_cfg)
  generate_config_includefile(
    FILE_NAME     "elunar_app_${ELUNAR_APP_HEADER}.h"
    FALLBACK_FILE "${CMAKE_CURRENT_LIST_DIR}/config/default_elunar_app_${ELUNAR_APP_HEADER}.h")
endforeach()

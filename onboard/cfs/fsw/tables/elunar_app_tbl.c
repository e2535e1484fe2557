/* The default limits. Slope and roughness are examples; every lander has its own. */
#include "cfe_tbl_filedef.h"
#include "elunar_app_tbl.h"

ELUNAR_APP_Table_t ELUNAR_APP_Limits = {
    .StepBudgetMacs     = 5000000,
    .ScrubBytes         = 16384,
    .MaxSlopeDeg        = 15.0f,
    .MaxRoughnessM      = 0.5f,
    .FootprintRadiusPx  = 1,
    .MinSunElevationDeg = 2.0f,
    .MaxSunElevationDeg = 88.0f,
};

CFE_TBL_FILEDEF(ELUNAR_APP_Limits, ELUNAR_APP.Limits, ELunarDTM limits, elunar_app_tbl.tbl)

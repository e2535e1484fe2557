/* All about messages of ELUNAR_APP, but their ids (elunar_app_msgids.h). */
#ifndef ELUNAR_APP_MSG_H
#define ELUNAR_APP_MSG_H

#include "elunar_app_fcncodes.h"
#include "elunar_app_interface_cfg.h"
#include "elunar_app_msgdefs.h"
#include "elunar_app_msgstruct.h"

#endif

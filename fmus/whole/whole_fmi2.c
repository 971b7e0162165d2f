/* The FMI 2.0 shell of a component that is a whole system (shell_hooks.h). */
#define UUV_WHOLE
#include "fmi2_shell.c"

; DE on, and nobody feeds the watchdog: 16 ms later the node starts anew.
.include "defs.inc"
.equ WDTCSR, 0x60
    wdr
    put WDTCSR, 0x18
    put WDTCSR, 0x08
    sbi DDRD_io, 2
    sbi PORTD_io, 2
1:  rjmp 1b

; What boot loaders of Nanos do with the reset flags, the watchdog and r2 before they start the program; not what they are for.
; KIND 0: ATmegaBOOT as it is on Nanos, built without watchdog support: waits a second for a programmer, whatever has reset the
; chip, and leaves the watchdog as it is. 1: Optiboot 4.4: clears MCUSR; after the reset pin its own watchdog ends the wait; else
; the program starts at once, with the watchdog off. 2: Optiboot 4.6: the same, and what was in MCUSR is in r2.
.include "defs.inc"
.equ WDTCSR, 0x60
.equ MCUSR, 0x54
.equ EXTRF, 1
.macro watchdog value
    ldi r18, \value
    ldi r19, 0x18
    wdr
    sts WDTCSR, r19
    sts WDTCSR, r18
.endm
    clr r1
    ldi r16, 0xff
    out SPL_io, r16
    ldi r16, 0x08
    out SPH_io, r16
    lds r16, MCUSR
.if KIND == 0
    ; 50 times 20 ms.
    ldi r20, 50
1:  ldi r24, lo8(64000)
    ldi r25, hi8(64000)
2:  sbiw r24, 1
    nop
    brne 2b
    dec r20
    brne 1b
.else
    sts MCUSR, r1
    sbrs r16, EXTRF
    rjmp 3f
    ; One second.
    watchdog 0x0e
4:  rjmp 4b
3:
.if KIND == 2
    mov r2, r16
.endif
    watchdog 0
.endif
    jmp 0

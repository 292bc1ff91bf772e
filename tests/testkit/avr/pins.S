; Counts the changes of PD3 by pin-change interrupt, asleep in between; the count is in SRAM.
.include "defs.inc"
    rjmp main
    .org 5 * 4
    lds r17, count
    inc r17
    sts count, r17
    reti
    .org 26 * 4
main:
    ldi r16, 0xff
    out SPL_io, r16
    ldi r16, 0x08
    out SPH_io, r16
    put count, 0
    put PCMSK2, 0x08
    put PCICR, 4
    ldi r16, 1
    out SMCR_io, r16
    sei
1:  sleep
    rjmp 1b
    .lcomm count, 1

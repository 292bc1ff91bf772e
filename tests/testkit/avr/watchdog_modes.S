; The watchdog. WDTCSR is set to CONTROL by the timed sequence. PB0 shows that it is; PB1 goes high in its interrupt,
; PB2 where the flags of the reset, shown in SRAM at 0x100, are those of a watchdog reset.
; MODE 0: nobody feeds it. 1: wdr every 10 ms, 5 times. 2: CONTROL is changed to CHANGED without the sequence. 3: with it.
; 4: interrupts on. 5: at the second start MCUSR is not cleared before the watchdog is to be turned off.
.include "defs.inc"
.ifndef MODE
.equ MODE, 0
.endif
.ifndef CHANGED
.equ CHANGED, 0
.endif
.equ WDTCSR, 0x60
.equ MCUSR, 0x54
.macro change value
    ldi r18, \value
    ldi r16, 0x18
    wdr
    sts WDTCSR, r16
    sts WDTCSR, r18
.endm
    rjmp main
    .org 6 * 4
    sbi PORTB_io, 1
    reti
    .org 26 * 4
main:
    ldi r16, 0xff
    out SPL_io, r16
    ldi r16, 0x08
    out SPH_io, r16
    sbi DDRB_io, 0
    sbi DDRB_io, 1
    sbi DDRB_io, 2
    lds r17, MCUSR
    sts 0x100, r17
    ldi r16, 0
.if MODE == 5
    sbrs r17, 3
.endif
    sts MCUSR, r16
    sbrs r17, 3
    rjmp 1f
    sbi PORTB_io, 2
    change 0
2:  rjmp 2b
1:  change CONTROL
    sbi PORTB_io, 0
.if MODE == 1
    ldi r20, 5
3:  ldi r24, lo8(40000)
    ldi r25, hi8(40000)
4:  sbiw r24, 1
    brne 4b
    wdr
    dec r20
    brne 3b
.endif
.if MODE == 2
    put WDTCSR, CHANGED
.endif
.if MODE == 3
    change CHANGED
.endif
.if MODE == 4
    sei
.endif
5:  rjmp 5b

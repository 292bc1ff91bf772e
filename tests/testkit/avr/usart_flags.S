; MODE 0: sends 1 and 2, and writes 3 to UDR0 without UDRE.
; MODE 1: sends 1, waits for TXC, sends 2; UCSR0A goes to SRAM from 0x100, behind that and when TXC was cleared.
; MODE 2: sends 1 with the interrupt of TXC on; how often it came goes to 0x100, UCSR0A to 0x101.
; MODE 3: receives from the start, turns the receiver off and on at 2 ms; UCSR0A goes to 0x100 at 6 ms.
; MODE 4: TXD is low as a port pin; sends 0xff and turns the transmitter off at once.
; DE is on in all but MODE 3.
.include "defs.inc"
.macro wait times
    ldi r24, (\times) & 0xff
    ldi r25, (\times) >> 8
1:  sbiw r24, 1
    brne 1b
.endm
.macro await_txc
2:  lds r17, UCSR0A
    sbrs r17, 6
    rjmp 2b
.endm
    rjmp main
    .org 20 * 4
    inc r20
    reti
    .org 26 * 4
main:
    ldi r16, 0xff
    out SPL_io, r16
    ldi r16, 0x08
    out SPH_io, r16
    sbi DDRD_io, 2
.if MODE != 3
    sbi PORTD_io, 2
.endif
.if MODE == 0
    usart_init 0x08
    put UDR0, 1
    wait 50
    put UDR0, 2
    put UDR0, 3
.endif
.if MODE == 1
    usart_init 0x08
    put UDR0, 1
    await_txc
    put UDR0, 2
    lds r17, UCSR0A
    sts 0x100, r17
    put UCSR0A, 0x40
    lds r17, UCSR0A
    sts 0x101, r17
.endif
.if MODE == 2
    ldi r20, 0
    usart_init 0x48
    sei
    put UDR0, 1
    wait 8000
    sts 0x100, r20
    lds r17, UCSR0A
    sts 0x101, r17
.endif
.if MODE == 3
    usart_init 0x10
    wait 8000
    put UCSR0B, 0x00
    put UCSR0B, 0x10
    wait 16000
    lds r17, UCSR0A
    sts 0x100, r17
.endif
.if MODE == 4
    usart_init 0x08
    sbi DDRD_io, 1
    put UDR0, 0xff
    put UCSR0B, 0x00
.endif
9:  rjmp 9b

@ Keeps a record of what USART1 receives, and sends what it is told to: at 38400 baud from the internal oscillator of 16 MHz.
@ CR1 and CR3 are its registers, SENDS how many characters it sends without being asked, and WAITS how long it looks away after each
@ character that it receives, in loops of some 4 clocks.
@
@ At 0x20000000 is how many entries there are; from 0x20000010 on each is four words: SR, DR, SR again, GPIOA's IDR before DR was read.
 .syntax unified
 .cpu cortex-m4
 .thumb
 .section .vectors,"a"
 .word 0x20010000
 .word reset + 1

 .text
reset:
 ldr r0, =0x40023800    @ RCC
 mov r1, #1             @ GPIOA
 str r1, [r0, #0x30]    @ AHB1ENR
 mov r1, #1 << 4        @ USART1
 str r1, [r0, #0x44]    @ APB2ENR
 ldr r0, =0x40020000    @ GPIOA
 ldr r1, =0x00077770    @ AF7 on PA9 to PA12
 str r1, [r0, #0x24]    @ AFRH
 ldr r1, =0xAAA80000    @ PA9 to PA15 are of peripherals
 str r1, [r0]           @ MODER
 mov r8, r0
 ldr r0, =0x40011000    @ USART1
 ldr r1, =417           @ 16 MHz / 38400
 str r1, [r0, #0x08]    @ BRR
 ldr r1, =CR3
 str r1, [r0, #0x14]
 ldr r1, =CR1
 str r1, [r0, #0x0C]
 ldr r4, =0x20000000
 add r5, r4, #0x10
 mov r6, #0
 str r6, [r4]
 ldr r7, =SENDS
 cbz r7, hear
send:
 ldr r1, [r0]
 tst r1, #0x80          @ TXE
 beq send
 str r7, [r0, #0x04]
 subs r7, #1
 bne send
hear:
 ldr r1, [r0]           @ SR
 tst r1, #0x20          @ RXNE
 beq hear
 ldr r9, [r8, #0x10]    @ IDR
 ldr r2, [r0, #0x04]    @ DR
 ldr r3, [r0]
 stmia r5!, {r1, r2, r3, r9}
 add r6, #1
 str r6, [r4]
 ldr r1, =WAITS
 cmp r1, #0
 beq hear
1: subs r1, #1
 bne 1b
 b hear
